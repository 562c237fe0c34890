"""All strategies in all worlds, each beside what is possible there."""
