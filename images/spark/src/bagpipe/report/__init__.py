"""The results of a job in the forms that others read: tables, CI systems, people."""
