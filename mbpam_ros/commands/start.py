"""What the executable ``mbpam`` calls: Ctrl-C ends it with one line from the first moment on."""

from __future__ import annotations

from mbpam_ros.commands.interrupt import interrupt_ends_it


def mbpam() -> int:
    """Run ``mbpam`` with the arguments in ``sys.argv``; return its exit status."""
    with interrupt_ends_it("mbpam"):
        from mbpam_ros.commands.mbpam import main
    return main()
