"""What stands beside our figures is what the papers print: their tables, copied once more by hand."""

import pytest

from dense_vs.sims.papers.vosvs.configurations import configuration


@pytest.mark.parametrize(
    ("name", "joints", "learned"),
    [
        ("head", "head_pan head_tilt", (0.00173, 0.00183)),
        ("arm lift", "arm_lift arm_roll", (-0.00157, 0.00321)),
        ("arm wrist", "wrist_flex arm_roll", (-0.00221, 0.00445)),
        ("arm both", "arm_lift wrist_flex arm_roll", (-0.00036, -0.00392, 0.00328)),
        ("base", "base_forward base_lateral", (-0.00179, 0.00173)),
        ("base grasp", "base_forward base_lateral", (-0.0004, 0.0004)),
    ],
)
def test_vos_vs_table_1(name, joints, learned):
    one = configuration(name)
    assert (" ".join(one.joints), one.learned) == (joints, learned)
