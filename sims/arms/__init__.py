"""Scenes of commercial arms, with their own meshes and plain materials, built at need from published packages."""
