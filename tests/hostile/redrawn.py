"""Posteriors that no run can have written."""

import xarray as xr


def redraw(path, kind, name):
    """Change the draws of a stored posterior."""
    with xr.open_datatree(path, engine="h5netcdf") as opened:
        tree = opened.load()
    groups = {g: n.to_dataset() for g, n in tree.children.items()}
    draws = groups["posterior"]
    name = name or str(next(iter(draws)))
    values = draws[name]
    match kind:
        case "nan" | "inf":
            draws[name] = values.where(values.draw != 3, float(kind))
        case "negative":
            draws[name] = -values
        case "huge":
            draws[name] = values * 1e300
        case "moved":
            draws[name] = values + 1e-6
        case "text":
            draws[name] = values.astype(str)
        case "integer":
            draws[name] = values.astype(int)
        case "dropped":
            draws = draws.drop_vars(name)
        case "none":
            draws = draws.isel(draw=slice(0))
        case "shape":
            draws[name] = values.isel(chain=0, drop=True)
        case _:
            draws = None
    groups = {g: one for g, one in groups.items() if kind != "group" or g != "posterior"}
    if draws is not None:
        groups["posterior"] = draws
    path.unlink()
    xr.DataTree.from_dict(groups).to_netcdf(path, engine="h5netcdf")
