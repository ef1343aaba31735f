"""What a person reads: tables, figures, the page, replays. It draws what `analysis` hands it."""
