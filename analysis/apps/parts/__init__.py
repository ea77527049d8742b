"""Parts of touches and of the link that a printer makes: solids, drawing and list from the numbers of a rig file."""
