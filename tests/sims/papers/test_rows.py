import json

import numpy as np

from dense_vs.files import write_json
from dense_vs.sims.papers.rows import Row, rows_json, rows_table, seeds_text


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


def test_numpys_numbers_are_written_as_json(tmp_path):
    rows = [Row("placed", None, np.int64(3), "", (np.int64(1),)), Row("error", None, np.float32(np.nan), "px", (1,))]
    write_json(tmp_path / "rows.json", {"rows": rows_json(rows)})
    read = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert [row["ours"] for row in read] == [3, None]
    assert read[0]["seeds"] == [1]
