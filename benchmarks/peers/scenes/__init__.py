"""One file a scene, each with ``SCENE``; a new file is found by itself."""
