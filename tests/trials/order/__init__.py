"""The trial of equal tables: the same rows in another order, and a joint a whole turn further."""
