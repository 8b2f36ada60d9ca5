def write(models, results):
    pass
