"""A volume object: making and reading it, its labels and channels, where its file is, its facts and its box."""
