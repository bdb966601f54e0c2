"""The serial chain: its axes from poses, Denavit-Hartenberg parameters, features placed through it."""
