"""The names of a batch's ends are those of the kernel's numbers."""

from dense_vs.kernels.simulation.servo_episode import LOST, MISSED, PENDING, REACHED
from dense_vs.point_servo import ReachEnd
from dense_vs.sims.batch.episode import ENDS


def test_each_number_has_its_own_name():
    assert len(ENDS) == len(set(ENDS)) == 4
    for number, end in (
        (PENDING, ReachEnd.PENDING),
        (REACHED, ReachEnd.REACHED),
        (MISSED, ReachEnd.MISSED),
        (LOST, ReachEnd.LOST),
    ):
        assert ENDS[int(number)] is end
