"""Whole missions: many inputs into one folder, resumed where they stopped.

The coordinator alone writes into the folder; what was finished is known from the manifest, so a batch may end
at any moment. `batch_run` goes from the inputs (`batch_inputs`) to the mission table; `coordinator` asks
`batch_folder` what is to be done for each and gives it to a `worker_pool` or a `dask_cluster`, which run
`worker_tasks`; `manifest` keeps what came of it in the `batch_folder`.
"""
