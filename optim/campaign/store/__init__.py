"""Where a campaign is kept: its folder, its chunks and the netCDF file made of them."""
