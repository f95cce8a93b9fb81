"""Export to formats of other tools, one file for each format in ``spacerobot/exports/formats``."""

from spacerobot.exports.export_format import ExportFormat, NoOptions

__all__ = ["ExportFormat", "NoOptions"]
