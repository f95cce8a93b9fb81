"""One search for a motion and many: asked, refined, kept, chosen among."""
