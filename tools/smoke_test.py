"""An installed wheel, without extras and away from the checkout: everything is in it and one frame goes through."""

import pathlib
from importlib import import_module, metadata

import numpy as np

import dense_vs

folder = pathlib.Path(dense_vs.__file__).parent
assert "site-packages" in folder.parts, f"{folder} is not an installed wheel"
for name in ("kernels/launch.py", "sims/models/arm.xml", "sims/models/planar.xml", "sims/cli/reach.py", "py.typed"):
    assert (folder / name).is_file(), f"{name} is missing from the wheel"
for name in ("dense_vs.cli.main", "dense_vs.kernels.jacobian.image_jacobian", "dense_vs.recording.video_recording"):
    import_module(name)

estimator = dense_vs.DenseJacobian(height=32, width=48, joints=2, device="cpu")
true = np.ones((32, 48, 2, 2), dtype=np.float32) * (100.0, 50.0)
random = np.random.default_rng(0)
for _ in range(60):
    dq = random.normal(0.0, 0.01, 2)
    estimator.update((true @ dq).astype(np.float32), dq)
error = float(np.abs(estimator.jacobian - true).max())
assert error < 1.0, f"J is {error} px/rad off"
print(f"dense-vs {metadata.version('dense-vs')} wheel works")
