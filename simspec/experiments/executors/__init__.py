"""Who does the runs of a sweep: ``contract.py`` is what every executor is, ``local.py`` this machine."""
