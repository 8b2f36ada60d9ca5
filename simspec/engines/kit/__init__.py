"""The base of every engine: the contract, and the process that an engine works in."""
