"""Whole missions: many inputs into one folder, resumed where they stopped.

One process, the coordinator, writes all that is in the folder; workers only read inputs and hand back
bytes. What was finished is known from the manifest alone, so a batch may end at any moment:
`batch_run` goes from the inputs (`batch_inputs`) to the mission table; `coordinator` asks
`batch_folder` what is to be done for each and gives it to a `worker_pool` or a `dask_cluster`, which run
`worker_tasks`; `manifest` keeps what came of it in the `batch_folder`.
"""
