"""Newton: reduced-coordinate trees and contact, by its solver Steel, in single precision on the processor."""
