"""From the fields of files to the raw channels of each wheel."""
