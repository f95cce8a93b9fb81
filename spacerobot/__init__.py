"""Robot arms on floating bases that dock with, capture, carry and release a floating object.

    import spacerobot as sr

    scene = sr.load_scene("docking")
    result = sr.simulate(scene)
    sr.animate(result, "docking.html")

The names of ``__init__.pyi`` are loaded when they are first used, so that importing the package
takes no time.
"""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
