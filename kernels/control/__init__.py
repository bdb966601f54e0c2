"""Commands: babbling and the servo law, for many worlds."""
