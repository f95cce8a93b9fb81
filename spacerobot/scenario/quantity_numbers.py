"""Sections with a key for each registered quantity: limits, constraints, weights of an objective.

The annotations are objects instead of strings, since pydantic before 2.13 evaluates ``__pydantic_extra__`` in
the module of the subclass.
"""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated

from pydantic import ConfigDict, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from spacerobot.common.section import Section
from spacerobot.quantities import Quantity, limited, weighted


class QuantityNumbers(Section):
    """Numbers by the keys of registered quantities, including those of plugins."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    @classmethod
    def quantities(cls) -> Mapping[str, Quantity]:
        """Quantities by their keys in this section."""
        raise NotImplementedError

    @classmethod
    def described(cls, quantity: Quantity) -> tuple[str, str]:
        """Unit and description of a quantity's key."""
        return quantity.unit, quantity.description

    @classmethod
    def known_keys(cls) -> Collection[str]:
        """Keys of the fields and of the quantities."""
        return [*cls.model_fields, *cls.quantities()]

    @classmethod
    def unit_of(cls, key: str, *, rotation: bool = False) -> str | None:
        """Unit of the number of a field or quantity; see :meth:`Section.unit_of`."""
        quantities = cls.quantities()
        if key in quantities:
            return cls.described(quantities[key])[0]
        return super().unit_of(key, rotation=rotation)

    @property
    def given(self) -> dict[str, float]:
        """Numbers in the scenario by the quantities' names, in the order of the registry."""
        values = self.model_extra or {}
        return {
            each.name: values[key] for key, each in self.quantities().items() if values.get(key) is not None
        }

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Schema with a property for each quantity."""
        schema = handler.resolve_ref_schema(handler(core_schema))
        properties = schema.setdefault("properties", {})
        for key, quantity in cls.quantities().items():
            unit, text = cls.described(quantity)
            properties[key] = {
                "type": "number",
                "description": f"{text} [{unit}]",
                "unit": unit,
                "minimum": 0,
            }
        schema["additionalProperties"] = False
        return schema


class QuantityLimits(QuantityNumbers):
    """Upper limits of quantities."""

    if not TYPE_CHECKING:  # pydantic's annotation of values, which type checkers take for a field
        __pydantic_extra__: dict[str, Annotated[float, Field(gt=0)] | None]

    @classmethod
    def quantities(cls) -> Mapping[str, Quantity]:
        """Quantities with a limit, by the key of the limit."""
        return limited()


class QuantityWeights(QuantityNumbers):
    """Weights of quantities in an objective."""

    if not TYPE_CHECKING:
        __pydantic_extra__: dict[str, Annotated[float, Field(ge=0)]]

    @classmethod
    def quantities(cls) -> Mapping[str, Quantity]:
        """Quantities with a weight, by the key of the weight."""
        return weighted()

    @classmethod
    def described(cls, quantity: Quantity) -> tuple[str, str]:
        """Unit and description of a quantity's weight."""
        return quantity.weight_unit("objective"), f"weight: {quantity.description}"
