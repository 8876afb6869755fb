"""Tables of text: CSV and its kin, plain or compressed."""
