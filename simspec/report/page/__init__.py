"""The report as one HTML file that needs nothing else: verdict, tables, plots, playback (``docs/guide/report.md``)."""
