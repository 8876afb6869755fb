"""Parquet: files, folders of parts, partitions."""
