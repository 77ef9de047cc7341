"""The commands of `osl`: each a dataclass of its arguments, with `execute`."""
