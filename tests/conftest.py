"""Settings of every test: hypothesis measures no time, which on a busy machine says nothing about the code."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("simspec", deadline=None)
settings.load_profile("simspec")
