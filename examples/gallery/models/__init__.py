"""What the scripts of the gallery put hair on: bodies by code, and the places of their parts."""
