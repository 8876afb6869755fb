"""Pictures and the report page: what a person looks at."""
