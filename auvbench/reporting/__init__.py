"""Show results to people: tables, figures, the page, replays. It draws what `analysis` computes."""
