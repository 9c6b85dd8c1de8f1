"""Every number that decides an answer, each with its reason. There are no others (`tests/test_deciding.py` counts)."""

# Smoothing
TRUST = 2.0  # a parameter moves by at most this factor in a step: its column is a tangent
FALL = 5.0  # noise levels fall or rise by at most this factor in a step (METHOD 8: freed at once they fall to nothing)
STILL = 0.05  # share of its noise or sd by which a next step moves no reading and no number, where a fit has converged
ROUNDS = 20  # steps of a fit at most; what is not still then is never used as if it were
LOUDER = (30.0, 15.0, 8.0, 4.0, 2.0)  # times their noise: sensors of force and acceleration come in so (METHOD 2)
SWITCH = 2  # samples before and after a contact begins or ends that belong to neither mode
TRUSTED = (0.1, 30.0)  # times what the samples show: noise levels of the readings that are believed
STAMPED = 0.01  # of a sample: sd of the clock of a run against that of its commands, however it is stamped
HELD = 2.0  # decays within a sample, of a speed or of what bends a servo: beyond, no force is held over it

# Selection
P_ALARM = 0.01  # family-wise chance of a false alarm, over all hypotheses that are tried
UNLIKELY = 0.05  # relative likelihood below which a rival has left the set
TIED = 1.0  # twice log likelihoods: less is not worth a mention (Kass and Raftery 1995); of a time step no error
SHARE = 0.02  # of the squared missing force at its place: less is no explanation an expert would give (METHOD 6)
REFINES = 0.10  # of what is left at its place: least share of what is asked for beside what is in (METHOD 5.6)
MOSTLY = 0.5  # of what is left at its place: a refinement that takes less is told as small
NOTHING = 1e-3  # of what such parts have, or of the force of a motion: less is nothing
STRETCHES = 10  # least number of stretches from which a spread is estimated
BELIEF = 2.0  # sd of the normal: as rarely may a gain be none; and prior ones that a size is believed (METHOD 5, 6)
CONFIDENCE = 0.95  # of intervals
RIVALS = 4  # refits beside the best in a round, and refits in a row that come to nothing, after which no more is asked
BUDGET = 400.0  # simulations of all samples: what is not found by then is told as what is left
TYPICAL = 0.5  # of the prior sd of such parts, where it is least: there a compound begins

# Telling
ASTRAY = 3.0  # sd, root mean square over its coordinates, from what is known of a start: no model may buy one farther
LOUD = 0.2  # of the force applied: a remainder is told beyond it
