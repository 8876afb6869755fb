"""The effects that come with the program, by what they act on; `terrain_cli.effects` lists them."""
