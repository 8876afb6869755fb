"""The effects that come with the program, one a module; the registry in `terrain_cli.effects` lists them."""
