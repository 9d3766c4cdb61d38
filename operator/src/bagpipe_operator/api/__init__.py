"""The words of the API: names, reasons, conditions, and how what others wrote is read. Pure."""
