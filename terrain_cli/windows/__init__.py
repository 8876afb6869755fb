"""Windows: samples that belong together, because the terrain is one."""
