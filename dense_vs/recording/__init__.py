"""What happened, as a stream of images, times and joints: videos with joint logs, and truth beside simulated ones.

May import: the ground and :mod:`dense_vs.robot`.
"""

from dense_vs.recording.joint_log import JointBuffer, JointLog
from dense_vs.recording.truth_file import TruthFile
from dense_vs.recording.video import VideoReader, VideoWriter
from dense_vs.recording.video_recording import Recording

__all__ = ["JointBuffer", "JointLog", "Recording", "TruthFile", "VideoReader", "VideoWriter"]
