"""Recordings as a stream of images, times and joints: readers of every format, how much is in them, and writers.

May import: the ground and :mod:`dense_vs.robot`.
"""

from dense_vs.recording.clock_offset import ClockOffset, MotionSamples, find_clock_offset
from dense_vs.recording.frame import ImageStream, RecordedFrame, RecordingFormat
from dense_vs.recording.joint_log import JointBuffer, JointLog
from dense_vs.recording.open_recording import open_recording
from dense_vs.recording.recorder import Recorder
from dense_vs.recording.recording import Episode, Recording
from dense_vs.recording.repeated_images import RepetitionFilter
from dense_vs.recording.replay import Replay
from dense_vs.recording.survey import Survey, survey_episode
from dense_vs.recording.truth_file import TruthFile
from dense_vs.recording.video_reader import VideoReader
from dense_vs.recording.video_writer import VideoWriter
from dense_vs.recording.writers import RecordingWriter, open_writer

__all__ = [
    "ClockOffset",
    "Episode",
    "ImageStream",
    "JointBuffer",
    "JointLog",
    "MotionSamples",
    "RecordedFrame",
    "Recorder",
    "Recording",
    "RecordingFormat",
    "RecordingWriter",
    "RepetitionFilter",
    "Replay",
    "Survey",
    "TruthFile",
    "VideoReader",
    "VideoWriter",
    "find_clock_offset",
    "open_recording",
    "open_writer",
    "survey_episode",
]
