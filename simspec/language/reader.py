"""The base of the types that fields have."""

from __future__ import annotations

from typing import Any

from pydantic import GetJsonSchemaHandler
from pydantic_core import core_schema

from simspec.language.document import INVALID
from simspec.language.strict import Fault, Faults, raised


class Reader:
    """A field type that reads one value by :meth:`read`; subclasses are frozen dataclasses used in ``Annotated``."""

    def read(self, value: Any) -> Any:
        """The value as the world wants it. Raises Faults."""
        raise NotImplementedError

    def written(self, value: Any) -> Any:
        """A value that was read, as a spec writes it, for the defaults in the schema and the reference."""
        return value

    def schema(self) -> dict[str, Any]:
        """Its JSON Schema."""
        raise NotImplementedError

    def unit(self) -> str:
        """The SI unit, for the reference; "" for none."""
        return ""

    def describe(self) -> str:
        """The type in words, for the reference."""
        raise NotImplementedError

    def _validate(self, value: Any) -> Any:
        if value is INVALID:
            raise raised([Fault((), "", reported=True)], None)
        try:
            return self.read(value)
        except Faults as error:
            raise raised(error.faults, None) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return self.schema()
