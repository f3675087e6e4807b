"""The paper's simulation (section 5) under every reading of its sensor: Tables 5 and 6, Figures 7 to 11."""
