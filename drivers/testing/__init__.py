"""The contract that every driver is held to: `contract_tests` says what, `contract` runs it."""
