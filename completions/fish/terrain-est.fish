terrain-est completion fish | source
