"""The agent base class under the import path that published agents use."""
