"""Settings of all tests."""

from hypothesis import settings

# The same examples in every run, so that a change is judged by what it changes; no deadline on a machine others use.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")
