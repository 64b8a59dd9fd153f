"""What the plant logs reaches the node's own log, once."""

import logging

from mbpam_ros.nodes.log_forwarding import forward_logs


class Heard(list):
    info = list.append


def test_the_newest_node_says_what_is_logged_below_the_name_and_nothing_else():
    first, second = Heard(), Heard()
    forward_logs("mbpam_ros.plant", first)
    forward_logs("mbpam_ros.plant", second)
    logging.getLogger("mbpam_ros.plant.tiers.adaptive").info("up to %d modes", 4)
    logging.getLogger("mbpam_ros.plant.tiers.adaptive").debug("not of interest")
    logging.getLogger("mbpam_ros.vision").warning("another's")
    assert (first, second) == ([], ["up to 4 modes"])
