"""Offline finite elements of the muscle (optional extra ``fem``). The running system only reads their results."""
