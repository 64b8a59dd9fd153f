"""The mechanics of muscles and one object in contact, compiled: rods, contacts, and the step that couples them."""
