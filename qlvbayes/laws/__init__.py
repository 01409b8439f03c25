"""Laws of the material: elastic ones and relaxations, one class a file."""
