"""The standard interfaces: thin views of `osl_env.world.World`."""
