"""Check what a decision by certainty alone would have said of a study."""

import pytest
from decisions import confirmed, decided


@pytest.mark.parametrize(
    ("stated", "certainty", "verdict", "effects", "group"),
    [
        ("missing_effect", {"drag": 0.95}, "missing_effect", ["drag"], []),
        ("missing_effect", {"drag": 0.7}, "ambiguous", ["drag"], ["drag"]),
        ("missing_effect", {"drag": 0.3}, "adequate", [], []),
        ("adequate", {}, "adequate", [], []),
        ("unexplained", {"drag": 0.95}, "partly_explained", ["drag"], []),
        ("unexplained", {"drag": 0.7}, "unexplained", [], []),
        ("partly_explained", {}, "unexplained", [], []),
        ("missing_effect", {"lag": 0.6, "drag": 0.95}, "ambiguous", ["drag", "lag"], ["lag"]),
        ("adequate", dict.fromkeys("abcd", 0.6), "unexplained", [], []),
    ],
)
def test_a_decision_by_certainty(stated, certainty, verdict, effects, group):
    case = decided({"verdict": stated, "kind": "single"}, certainty, 0.9)
    assert (case["verdict"], case["effects"], case["group"]) == (verdict, effects, group)
    assert case["kind"] == "single"


@pytest.mark.parametrize(
    ("stated", "named", "certainty", "verdict", "kept"),
    [
        ("missing_effect", ["drag"], {"drag": 0.6}, "missing_effect", ["drag"]),
        ("missing_effect", ["drag"], {"drag": 0.4}, "unexplained", []),
        (
            "missing_effect",
            ["drag", "lag"],
            {"drag": 0.9, "lag": 0.4},
            "partly_explained",
            ["drag"],
        ),
        ("partly_explained", ["drag"], {"drag": 0.1}, "unexplained", []),
        ("partly_explained", ["drag"], {}, "partly_explained", ["drag"]),
        ("adequate", [], {}, "adequate", []),
    ],
)
def test_a_name_of_little_certainty_is_taken_back(stated, named, certainty, verdict, kept):
    case = confirmed({"verdict": stated, "effects": named, "group": []}, certainty)
    assert (case["verdict"], case["effects"]) == (verdict, kept)
