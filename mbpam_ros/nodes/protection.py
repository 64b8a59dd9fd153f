"""What to say where SROS2 was asked for and cannot be had.

The wheels of PyPI are built without the security plug-ins of Fast DDS: with an enclave at hand ROS then refuses to make
a node, and without one, unless told to enforce, it goes on unprotected.
"""

from __future__ import annotations

import os

_ENABLE, _KEYSTORE, _STRATEGY = "ROS_SECURITY_ENABLE", "ROS_SECURITY_KEYSTORE", "ROS_SECURITY_STRATEGY"


def _asked_for() -> bool:
    return os.environ.get(_ENABLE, "").lower() == "true"


def unprotected() -> str | None:
    """Return that the nodes are going to run unprotected though protection was asked for, or None."""
    if not _asked_for() or os.environ.get(_KEYSTORE) or os.environ.get(_STRATEGY) == "Enforce":
        return None
    return f"{_ENABLE} is set, but {_KEYSTORE} is not: nothing is signed or encrypted, anybody may command the gripper"


def without_security(error: RuntimeError) -> str | None:
    """Return what to say of ROS's refusal in one line, or None where no protection was asked for."""
    if not _asked_for():
        return None
    reason = " ".join(str(error).split())
    if "security libraries" in reason:
        return (
            f"{_ENABLE} is set, but this Fast DDS has no security plug-in, as none from PyPI has: unset it, or run in "
            "a ROS 2 installation that has one, with config/security/policy.xml"
        )
    return f"{_ENABLE} is set, and ROS refuses: {reason}"
