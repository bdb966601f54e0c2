"""``dense-vs learn-model``: learn kinematics, marker positions and cameras of a recorded arm from pixels of markers.

The recording is an .npz file with these arrays, for T postures, n joints, c cameras and m features:

pixels (T, c, m, 2) [px], NaN where a feature was not seen, and image_sizes (c, 2), height and width [px];

joints (T, n) [rad], read exactly or with noise, or actions (T - 1, n) [rad], the joint steps that were commanded;

with a Cartesian controller poses (T, 4, 4) or actions (T - 1, 4, 4);

where known, intrinsics (c, 4): fx, fy, cx, cy [px], roughly right; intrinsics_sigma (2,): standard deviations of the
focal lengths, as a share, and of the principal points [px]; and feature_link (m,): the joint, counted from 1, behind
which each feature stands.
"""

import argparse
from pathlib import Path

import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import check_writable, read_arrays, write_json
from dense_vs.generative import GenerativeModel, Observations
from dense_vs.view.provenance import versions
from dense_vs.view.tables import table

ARRAYS = ("pixels", "image_sizes", "joints", "actions", "poses", "intrinsics", "intrinsics_sigma", "feature_link")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("recording", type=Path, help=".npz file with the arrays above")
    parser.add_argument("--out", type=Path, required=True, metavar="NPZ", help="file for the model")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the report here")
    parser.add_argument(
        "--state",
        default="observed",
        metavar="KIND",
        help="what is known of the joints: observed, noisy (readings), actions (commands alone) (default: observed)",
    )
    parser.add_argument(
        "--controller", default="joint", metavar="KIND", help="what it commands: joint or cartesian (default: joint)"
    )
    parser.add_argument(
        "--kinematics",
        default="poe",
        metavar="FORM",
        help="poe, product of exponentials, or dh, Denavit-Hartenberg (default: poe)",
    )
    parser.add_argument(
        "--method",
        default="lm",
        metavar="NAME",
        help="lm, Levenberg-Marquardt, or paper, L-BFGS in three stages as published, with dh (default: lm)",
    )
    parser.add_argument(
        "--noise",
        default="constant",
        metavar="KIND",
        help="of actions: constant or proportional to them (default: constant)",
    )
    parser.add_argument(
        "--distortion",
        type=int,
        default=0,
        metavar="K",
        help="radial distortion coefficients to learn, 0 to 2 (default: 0)",
    )
    parser.add_argument(
        "--held-out",
        type=int,
        default=0,
        metavar="N",
        help="keep the last N postures from learning and print the error on them; needs --state observed (default: 0)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random starts (default: 0)")


def run(arguments: argparse.Namespace) -> None:
    """Run the command."""
    obs = read_recording(arguments.recording)
    for path in (arguments.out, arguments.json):  # wrong here, not after the learning
        if path is not None:
            check_writable(path)
    kept = len(obs) - arguments.held_out
    if arguments.held_out < 0 or kept < 2:
        raise DenseVSError(f"--held-out is {arguments.held_out}; expected 0 to {len(obs) - 2} of {len(obs)} postures")
    if arguments.held_out and (arguments.state != "observed" or arguments.controller != "joint"):
        raise DenseVSError("--held-out needs --state observed and --controller joint: else the true state is not known")
    model = GenerativeModel.fit(
        obs[:kept],
        kinematics=arguments.kinematics,
        state=arguments.state,
        controller=arguments.controller,
        seed=arguments.seed,
        method=arguments.method,
        noise=arguments.noise,
        distortion=arguments.distortion,
    )
    model.save(arguments.out)
    report = model.report
    rows = [
        [stage.name, f"{stage.loss:.4g}", f"{stage.rms:.3g}", str(stage.iterations), f"{stage.seconds:.2f}"]
        for stage in report.stages
    ]
    print(table(["stage", "loss", "RMS", "iterations", "seconds"], rows))
    print(f"mean error {report.mean_error_px:.3f} px; {'converged' if report.converged else 'not converged'}")
    if report.expected_error_px is not None:
        print(f"mean error to be expected on other postures, without noise {report.expected_error_px:.3f} px")
    summary = report.as_dict() | {"samples": kept, "versions": versions()}
    if report.joint_sigma is not None:
        print(f"noise of the state {report.joint_sigma:.4g} rad")
    if report.pose_sigma is not None:
        print(f"noise of the poses {report.pose_sigma[0]:.4g} rad, {report.pose_sigma[1]:.4g} m")
    if arguments.held_out:
        held = obs[kept:]
        errors = np.linalg.norm(model.pixels(held.joints) - held.pixels, axis=-1)
        known = errors[np.isfinite(errors)]
        if len(known) == 0:
            raise DenseVSError(f"none of the {arguments.held_out} postures held out shows a known feature")
        summary["held_out_mean_error_px"] = float(known.mean())
        print(f"mean error on {arguments.held_out} postures held out {known.mean():.3f} px")
    for outlier in report.outliers:
        print(
            f"left out as a mistake: feature {outlier.feature} of camera {outlier.camera} in posture {outlier.sample}, "
            f"{outlier.error_px:.1f} px off"
        )
    for sample, camera, a, b in report.swapped:
        print(f"labels look exchanged: features {a} and {b} of camera {camera} in posture {sample}")
    for words in report.unobservable:
        print(f"not determined: {words}")
    if arguments.json is not None:
        write_json(arguments.json, summary)
    print(f"model in {arguments.out}")


def read_recording(path: Path) -> Observations:
    """Observations from an .npz file as the command takes it.

    Raises:
        DenseVSError: not such a file, or arrays missing, unknown or unfit.
    """
    content = read_arrays(path, "a recording of features")
    unknown = sorted(set(content) - set(ARRAYS))
    missing = [name for name in ("pixels", "image_sizes") if name not in content]
    if unknown or missing:
        what = f"arrays {', '.join(unknown)} are unknown" if unknown else f"array {missing[0]} is missing"
        raise DenseVSError(f"{path}: {what}; expected some of {', '.join(ARRAYS)}")
    sizes = content.pop("image_sizes")
    if sizes.ndim != 2 or sizes.shape[1] != 2 or sizes.dtype.kind not in "iu":
        raise DenseVSError(
            f"{path}: image_sizes has shape {sizes.shape}, dtype {sizes.dtype}; expected (c, 2) integers"
        )
    return Observations(**content, image_sizes=[(int(h), int(w)) for h, w in sizes])
