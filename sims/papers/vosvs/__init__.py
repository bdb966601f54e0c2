"""Experiments of VOS-VS (Griffin, Florence, Corso; WACV 2020): servoing, depth and grasping from object masks.

A module named after an experiment runs it and reports its figures: ``learn`` (Table 1, Figs. 8, 9, 18), ``trial``
(Table 2), ``depth_log`` (Fig. 6), ``step_response`` (Figs. 10 to 12), ``track`` (Fig. 13) and ``pick_place`` (Figs. 5,
19). The other modules hold what the experiments are made of.
"""
