"""Programs of five languages, run by the interpreters of the product on arms that are computed apart from it."""
