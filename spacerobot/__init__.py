"""Simulation, planning and tuning of robot arms on floating bases that capture and dock floating objects.

    import spacerobot as sr

    scene = sr.load_scene("docking")
    result = sr.simulate(scene)
    sr.animate(result, "docking.html")

The names of ``__init__.pyi`` are loaded at first use, so that the import of the package takes little time.
"""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
