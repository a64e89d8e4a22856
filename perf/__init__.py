"""The measurements; `python -m perf.NAME` runs one."""
