"""Experiments of VOS-VS (Griffin, Florence, Corso; WACV 2020): servoing, depth and grasping from object masks.

A module named after an experiment runs it and reports its figures: ``learn`` (Table 1, Figs. 8, 9, 18), ``trial``
(Table 2), ``pick_place`` (Fig. 5), ``depth_log`` (Fig. 6), ``step_response`` (Figs. 10 to 12), ``track`` and
``track_person`` (Fig. 13), ``segmentations`` (Figs. 14 to 17), ``clutter`` (Fig. 19) and ``collaboration`` (Fig. 20).
The other modules hold what the experiments are made of.
"""
