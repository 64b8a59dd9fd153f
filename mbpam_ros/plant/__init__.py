"""The simulated gripper behind one face: reset, step, observe.

From a scene to a step: ``scene`` reads what is there, and how a file wants it computed; ``planner`` makes that a
``fidelity``; ``plant`` puts both together, with ``placement`` setting the object among the muscles and
``tiers.registry`` building what moves them. A step of the plant is one of valves and chambers and one of its tier;
that of the tiers arc and rod is compiled, in ``mechanics``.
"""
