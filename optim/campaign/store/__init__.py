"""Store of a campaign: its folder, its chunks and the netCDF file merged from them."""
