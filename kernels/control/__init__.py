"""What is commanded: babbling and the servo law, for many worlds."""
