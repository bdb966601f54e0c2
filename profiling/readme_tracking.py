"""Lines about the few-shot segmenter that follows an object, for the tables."""

from results_file import Result, committed


def tracking_lines() -> list[str]:
    """A paragraph beside that on masks."""
    if not committed("tracking"):
        return []
    result = Result("tracking")
    cores = result.content["machine"]["cores"]
    return [
        f"Following an object from image to image (`profiling/tracking.py`; {result.when()}): a mask takes "
        f"{result['tracking, all images: CPU, median [ms]']:.0f} ms of CPU (99th percentile "
        f"{result['tracking, all images: CPU, 99th percentile [ms]']:.0f}), and is there after "
        f"{result['tracking, all images: until the mask, median [ms]']:.0f} ms (99th percentile "
        f"{result['tracking, all images: until the mask, 99th percentile [ms]']:.0f}) with {cores} cores; the whole "
        f"image, looked at anew, {result['anew: CPU, median [ms]']:.0f} and "
        f"{result['anew: until the mask, median [ms]']:.0f} ms. IoU is {result['tracking: mean IoU']:.3f} (anew "
        f"{result['anew: mean IoU']:.3f}), below 0.5 in {result['tracking: images with IoU below 0.5']:.1%} of the "
        f"images (anew {result['anew: images with IoU below 0.5']:.1%}); "
        f"{result['tracking: images whose window was doubted']:.1%} were looked at as a whole because what the window "
        "held was doubted.",
        "",
    ]


def few_tracking_lines() -> list[str]:
    """A row of the README's table."""
    if not committed("tracking"):
        return []
    result = Result("tracking")
    return [
        "| mask of an object tracked in simulated 640x480 images: CPU time, median / 99th percentile [ms]; IoU | "
        f"{result['tracking, all images: CPU, median [ms]']:.0f} / "
        f"{result['tracking, all images: CPU, 99th percentile [ms]']:.0f}; {result['tracking: mean IoU']:.2f} |"
    ]
