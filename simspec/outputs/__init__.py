"""The one place that writes, replaces and removes what a user named: whole or not at all, and never what simspec did not make.

``targets`` says what may be written, before any work is done; ``writing`` writes; ``staging`` is how (next to the target,
synced, renamed); ``marker`` is the file that says that a folder is simspec's; ``reading`` reads what others may have put there.
"""
