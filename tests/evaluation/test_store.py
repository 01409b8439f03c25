"""Finished studies are stored, found again, and kept apart by the code that ran them."""

from qlvbayes.evaluation.store import Store, code_digest, run_missing

PLAN = "a plan"


def test_finished_studies_are_not_run_again(tmp_path):
    ran, reported = [], []

    def pretend(index):
        ran.append(index)
        return {"plan": PLAN, "index": index}

    key, path = PLAN, tmp_path / "a" / "store.jsonl"
    run_missing(pretend, Store(path, key), range(2))
    run_missing(pretend, Store(path, key), range(4), lambda *done: reported.append(done))
    assert ran == [0, 1, 2, 3]
    assert reported == [(0, 2), (1, 2), (2, 2)]
    assert Store(path, key).missing(6) == [4, 5]
    assert not Store(path, "another").cases
    assert sorted(Store(path).cases) == [0, 1, 2, 3]


def test_parts_of_several_processes_are_read_together_and_cut_lines_removed(tmp_path):
    path, key = tmp_path / "store.jsonl", PLAN
    for part in (0, 1):
        store = Store(path, key, part)
        store.add({"plan": PLAN, "index": part})
        store.add({"plan": PLAN, "index": part + 2})
    cut = tmp_path / "store.jsonl.1"
    cut.write_text(cut.read_text()[:-30])
    assert sorted(Store(path, key).cases) == [0, 1, 2]
    Store(path, key, 1).add({"plan": PLAN, "index": 3})
    assert sorted(Store(path, key).cases) == [0, 1, 2, 3]
    assert [c["index"] for c in Store(path, key).first(3)] == [0, 1, 2]


def test_the_digest_is_of_code_that_may_change_an_outcome(tmp_path):
    """Not of words about it, nor of code that only looks at what came out."""
    law, figure = tmp_path / "laws" / "hertz.py", tmp_path / "plots" / "bars.py"
    for file in (law, figure):
        file.parent.mkdir()
        file.write_text("POWER = 1.5\n")
    first = code_digest(tmp_path)
    law.write_text('"""Of a sphere."""\n\nPOWER = 1.5  # Hertz 1881\n')
    figure.write_text("POWER = 2.0\n")
    assert code_digest(tmp_path) == first
    law.write_text("POWER = 2.0\n")
    assert code_digest(tmp_path) != first
    law.rename(law.with_name("sphere.py"))
    figure.rename(tmp_path / "laws" / "hertz.py")
    assert code_digest(tmp_path) != first
