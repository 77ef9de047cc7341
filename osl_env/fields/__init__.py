"""Wind and gas fields: the grid, its file, and what ships.

Importers and exporters of other programs' files are in `osl_env.fields.gaden` and `osl_env.fields.openfoam`.
"""

from osl_env.fields.field import Field
from osl_env.fields.library import field_names, load_field
from osl_env.fields.statistics import statistics
from osl_env.fields.storage import MAX_FIELD_BYTES, read_field, save_field

__all__ = [
    "MAX_FIELD_BYTES",
    "Field",
    "field_names",
    "load_field",
    "read_field",
    "save_field",
    "statistics",
]
