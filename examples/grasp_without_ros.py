"""Grasp a bulb, lift it, and let go: the whole gripper in plain Python, without ROS.

python examples/grasp_without_ros.py [SCENE]
"""

import sys

from mbpam_ros import Phase, Simulation

scene = sys.argv[1] if len(sys.argv) > 1 else "bulb"
simulation = Simulation(scene)
resting = simulation.run(0.3).object_in_world
print(simulation.grasp().reason)
simulation.run_until(lambda: simulation.decision.phase is Phase.HOLDING)
simulation.lift()
held = simulation.run(2.0)
rise_m = resting.position_m[2] - held.object_in_world.position_m[2]  # in the world z points down
print(f"hand up by {1e3 * held.hand_lift_m:.0f} mm, object by {1e3 * rise_m:.0f} mm")
print(f"forces of the fingers on it [N]:\n{held.finger_force_n.round(3)}")
simulation.release()
print(f"let go: {simulation.run(2.0).object_in_world.position_m.round(3)} m")
