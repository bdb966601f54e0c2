"""J from a recording: a video and a CSV file of joint readings, as `dense-vs estimate` does it.

The recording is made first, by a simulated arm, with the truth of some frames beside it; bring your own instead.
"""

from pathlib import Path

from dense_vs.cli import main
from dense_vs.jacobian import jacobian_error
from dense_vs.pipeline import estimate_recording
from dense_vs.recording import Recording, TruthFile

OUT = Path("out/examples/recording")

main(["record", "--robot", "arm", "--seconds", "10", "--seed", "4", "--out", str(OUT)])
recording = Recording(OUT / "video.mp4", OUT / "joints.csv")
truth = TruthFile.read(OUT / "truth.npz", recording.log.names)

errors = []
for frame, estimator in estimate_recording(recording):
    if frame.flow is not None and (true := truth.at(frame.time)) is not None:
        errors.append(jacobian_error(estimator.to_numpy(), *true).median)
estimator.save(OUT / "jacobian.npz")
print(f"error of J where the truth is known: {', '.join(f'{error:.3f}' for error in errors)}")
assert errors[-1] < 0.15
