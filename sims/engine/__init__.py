"""One simulated robot with exact truth: scene, physics, renderer, cameras, textures, disturbances."""
