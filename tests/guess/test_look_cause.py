"""``look --cause``: a guess of every pad next to what look prints, and JSON stays JSON."""

import json

from support.endtoend import PADS, call


def test_a_guess_is_printed_next_to_json():
    status, out, err = call("look", PADS, "--pad", "B", "--cause", "--json")
    assert status == 0
    assert [pad["pad"] for pad in json.loads(out)["pads"]] == ["B"]
    (line,) = (line for line in err.splitlines() if line.startswith("pad B: "))
    assert line.startswith("pad B: First guess from one fit: ")
    assert line.endswith("`qlvbayes diagnose` decides.")
