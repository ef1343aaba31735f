"""Show results as tables, figures, pages and replays; `analysis` computes the numbers of reports."""
