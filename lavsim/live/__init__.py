"""A drive under way in a local web page: steered by keys, or an agent watched."""
