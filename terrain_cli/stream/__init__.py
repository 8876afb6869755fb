"""A drive followed while it goes on: rows that arrive become samples, segments, and rows of the table.

- `arriving_samples`: rows to the samples of each wheel, in order, a part after another.
- `online_cuts`: where the soil changed, told as soon as it is sure.
- `followed_wheel`: one wheel, from its samples to the rows of its segments, of which one is open.
- `model_watch`: whether a model still fits what arrives.
- `growing_table`: rows written as they come.
- `follow`: all of it together.
"""
