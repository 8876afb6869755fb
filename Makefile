# Short names for what CONTRIBUTING.md says. Using the program needs none of them.
bin := .venv/bin

.PHONY: test lint man sample site gallery

test:
	$(bin)/pytest -n auto

lint:
	$(bin)/ruff check .
	$(bin)/ruff format --check .
	$(bin)/mypy

man:
	$(bin)/python man/generate.py
	$(bin)/python man/criteria_page.py

sample:
	$(bin)/python sample_data/make.py

site:
	$(bin)/sphinx-build -q -W --keep-going docs build/site

gallery:
	$(bin)/python -m benchmarks.effect_gallery
