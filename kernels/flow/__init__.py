"""Farneback's optical flow: expansions, displacement equations, pyramid levels."""
