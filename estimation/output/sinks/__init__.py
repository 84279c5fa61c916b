"""Ways out for answers, beside the table and the record that every run has."""
