"""A world seen without a run: live in the browser, in notebooks, and videos of runs."""
