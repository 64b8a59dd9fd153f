"""The finite element muscle, a verb each. "mbpam fe VERB --help" tells of one.

They need the extra "fem". Pictures are written beside the result. An interrupt (Ctrl-C) keeps what is finished; the
same command goes on from there.
"""

from mbpam_ros.commands.verb import Verb

VERBS = (
    Verb("paper", "the paper's 32 designs (Tables 1, 2, 5) and PSC, beside its values", "fe.paper", resumes=True),
    Verb("curve", "one design: bend against pressure", "fe.curve"),
    Verb("effects", "effect of a, b, c and n, as figure 6", "fe.effects", resumes=True),
    Verb("ablations", "what each choice of the model does to the error", "fe.ablations", resumes=True),
    Verb("mesh", "error of the meshes, by refinement", "fe.mesh", resumes=True),
    Verb("law", "M(p, kappa), V(p, kappa), stretch, EA and GJ of the initial design", "fe.law", resumes=True),
    Verb("unequal", "unit cells with unequal chamber pressures", "fe.unequal", resumes=True),
    Verb("ends", "what the two ends add to the rod of unit cells: turn, length, shift", "fe.ends", resumes=True),
    Verb("muscle", "one state of the whole muscle: pressures, loads on its tip, gravity in any direction", "fe.muscle"),
    Verb("states", "the whole muscle in the states that the rod is set beside", "fe.states", resumes=True),
    Verb("whole", "the whole muscle in three dimensions, free and at a plate", "fe.whole", resumes=True),
)
