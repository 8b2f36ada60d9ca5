"""What every engine is built on: the contract, and the process that an engine works in."""
