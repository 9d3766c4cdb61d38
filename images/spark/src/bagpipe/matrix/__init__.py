"""Test cases from variables: combinations, rules that remove or add some, samples, templates."""
