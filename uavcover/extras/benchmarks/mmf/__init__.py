"""The 24 multimodal functions of the paper: problems, runs, tables and figures."""
