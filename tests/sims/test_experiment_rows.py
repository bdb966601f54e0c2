import json

from dense_vs.sims.experiments.rows import Row, rows_json, rows_table, seeds_text


def test_paper_without_a_value_is_a_dash_in_the_table_and_null_in_json():
    rows = [Row("error", None, 0.5, "px", (0, 1, 2)), Row("success", 0.42, 1.0, "", (7,))]
    lines = rows_table(rows).splitlines()
    assert lines[2].split() == ["error", "-", "0.5", "px", "0-2"]
    assert lines[3].split() == ["success", "0.42", "1", "7"]
    assert json.loads(json.dumps(rows_json(rows)))[0] == {
        "name": "error",
        "paper": None,
        "ours": 0.5,
        "unit": "px",
        "seeds": [0, 1, 2],
    }


def test_seeds_are_written_in_short():
    assert seeds_text([2, 0, 1]) == "0-2"
    assert seeds_text([7]) == "7"
    assert seeds_text([3, 9]) == "3,9"
