"""`qlvbayes fit` of one pad as a user starts it: cold, and with a warm compile cache."""

import time

from timing import into_new_folders


def shell_times(warm_runs=1):
    """Seconds: cold, then the median of warm runs."""
    cold, *warm = into_new_folders("fit", "data/pads.csv", "--pads", "B", runs=1 + warm_runs)
    return cold, sorted(warm)[warm_runs // 2]


def where_time_goes():
    """(part, seconds) of a warm fit, in a process of its own."""
    began = time.perf_counter()
    import qlvbayes as q
    from qlvbayes.fitting.ensemble import Settings, sample
    from qlvbayes.fitting.optimum import find_start
    from qlvbayes.motion.experiment import prepare

    marks = [("imports", time.perf_counter() - began)]

    def mark(name, function, *arguments, **options):
        start = time.perf_counter()
        value = function(*arguments, **options)
        marks.append((name, time.perf_counter() - start))
        return value

    study = mark("reading the file", q.read_study, "data/pads.csv")
    experiment = mark("motion, phases, noise floor", prepare, study.pad("B"))
    trials = experiment.with_role("fit")
    start = mark("reduction, modes", find_start, experiment, q.Choices(), trials)
    mark("emcee", sample, start.posterior, start.normal, Settings())
    return marks


if __name__ == "__main__":
    for name, seconds in where_time_goes():
        print(f"{name}\t{seconds:.2f}")
