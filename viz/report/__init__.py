"""One page about one or several results, a campaign or a comparison, section by section."""
