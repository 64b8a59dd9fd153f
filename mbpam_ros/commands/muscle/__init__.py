"""Your own muscle: a drawing in config/muscles, and what is found out about it.

"mbpam muscle VERB --help" tells of one.
"""

from mbpam_ros.commands.verb import Verb

VERBS = (
    Verb("build", "finite elements, metamodels, front and law of a drawing", "muscle.build", resumes=True),
    Verb("moulds", "moulds A to D to print, and how to cast with them", "muscle.moulds"),
    Verb("calibrate", "factors on a muscle's law from the curves of the rig", "muscle.calibrate"),
)
