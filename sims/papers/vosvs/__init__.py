"""Experiments of VOS-VS (Griffin, Florence, Corso; WACV 2020): servoing, depth and grasping from object masks."""
