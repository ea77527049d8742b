"""What long trials are made of: generators and oracles that share no code with what they judge."""
